"""The claims of a plan's segments, derived again."""
