"""Cone programs, solvers and routes."""
