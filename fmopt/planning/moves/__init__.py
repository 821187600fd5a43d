"""Moves along held contacts, and the planes that keep parts separate meanwhile."""
