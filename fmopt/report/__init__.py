"""The report room: figures, the motion in three dimensions, and the page, all from the plan document alone."""
