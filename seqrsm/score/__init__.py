"""Utility scores of images, each with its standard error."""
