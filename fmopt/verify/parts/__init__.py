"""The parts of a plan, their pieces, surfaces and contacts."""
