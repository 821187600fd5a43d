"""Insertion motions that work although the clearance is smaller than the error, with proof."""

__version__ = "0.1.0"
