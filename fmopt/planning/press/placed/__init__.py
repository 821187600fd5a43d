"""Rows of presses, whoever proposed them: contacts that they can reach, room, rests, jams, errors."""
