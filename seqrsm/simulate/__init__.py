"""Engines that turn a scene, a scattering table and a sensor into an image."""
