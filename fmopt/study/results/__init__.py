"""The results of a study as tables, figures and a page."""
