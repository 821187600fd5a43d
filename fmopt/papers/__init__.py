"""Methods of the papers as they are published, on the same parts."""
