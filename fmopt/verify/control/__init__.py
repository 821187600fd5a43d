"""The strategies of a plan's segments, and what it says of failing."""
