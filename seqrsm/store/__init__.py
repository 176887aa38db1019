"""The memory of a campaign: runs, scores, looks, and an event for every change."""
