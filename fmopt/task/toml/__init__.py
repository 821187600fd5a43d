"""Problem, model and assembly files: TOML, with the line of every key, and the tables that it must hold."""
