"""What people work with from Python: problems, plans and studies as values that say, draw and save themselves."""
