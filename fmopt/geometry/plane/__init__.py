"""Plane geometry with exact curves: segments, circular and conic arcs, regions, booleans and Minkowski sums."""
