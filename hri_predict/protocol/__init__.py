"""The messages and their encoding; the DBC files and documents come from the same definition."""
