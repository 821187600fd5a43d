"""Presses: sequences proposed from the mouth of the hole, chosen and examined in the physics engine."""
