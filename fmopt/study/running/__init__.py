"""The runs of a study: handed out, worked off, kept."""
