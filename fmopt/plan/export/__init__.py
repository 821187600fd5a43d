"""Plans in the formats that robots take: URScript, ROS 2, tables."""
