"""Vectors, poses and ellipsoids, and the frozen values that hold them."""
