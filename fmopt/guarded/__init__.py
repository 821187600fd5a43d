"""The guarded moves of a plan file, and its contacts, as whoever runs them needs them."""
