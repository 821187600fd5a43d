"""A plan file read into values, or refused."""
