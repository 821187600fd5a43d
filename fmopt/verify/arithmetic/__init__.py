"""Exact and fixed-point arithmetic, and exact tests of points and planes."""
