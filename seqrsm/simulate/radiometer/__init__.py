"""The Point Radiation Model: a scanning radiometer's image of a scene."""
