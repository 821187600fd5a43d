"""From a problem to a controlled motion: search, placement, robustness, control."""
