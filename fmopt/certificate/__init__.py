"""What a segment claims: rows of signed distances over a tube, separating planes of convex pieces, contacts kept."""
