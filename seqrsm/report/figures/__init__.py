"""The figures of a report, their data, and their files."""
