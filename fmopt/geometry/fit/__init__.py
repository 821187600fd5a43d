"""What goes where: the fit of two solids, found by placing sections of the one in openings of the other."""
