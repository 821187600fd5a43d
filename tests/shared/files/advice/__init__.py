"""Advice that errors give, all of it as it stands in the sources, and what a reader does who takes it at its word."""
