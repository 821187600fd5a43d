"""STEP files, read by a CAD kernel in a process of its own."""
