"""The next runs: criteria, and the greedy batch built from them."""
