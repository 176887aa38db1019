"""Backscatter of the ground: tables with provenance and the published models that fill them."""
