"""Best-first search for a sequence of contact states."""
