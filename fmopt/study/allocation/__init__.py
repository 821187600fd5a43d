"""Tolerances loosened as far as the insertion stays certified."""
