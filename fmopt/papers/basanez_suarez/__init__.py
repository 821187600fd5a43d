"""Planar contacts under uncertainty: the sets of possible contact configurations of [BasanezSuarez]."""
