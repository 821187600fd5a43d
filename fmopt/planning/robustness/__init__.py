"""What errors a motion tolerates, and which contacts they could make."""
