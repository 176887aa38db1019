"""The Point Scattering Model: a radar's image of a scene, RSL TR 380-1 chapter 3."""
