"""When to stop a campaign, what the interval then is worth, and how a rule behaves before it is used."""
