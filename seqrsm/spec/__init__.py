"""The specification of a campaign: ``campaign.toml`` read, its tables, checks and line numbers, and templates."""
