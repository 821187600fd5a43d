"""Meshes: read from files, closed, and their facets made plane."""
