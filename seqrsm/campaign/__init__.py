"""The campaign: specification, store, and the loop that joins statistics and physics."""
