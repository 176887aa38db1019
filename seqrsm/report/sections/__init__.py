"""The pages of a report, a section each: analyses and store in, blocks out."""
