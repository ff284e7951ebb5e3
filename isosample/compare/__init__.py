"""Measures of the difference between images."""
