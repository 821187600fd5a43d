"""Drawings of one thing each."""
