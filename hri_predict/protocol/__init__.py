"""The messages and their encoding; DBC and documents are generated from the same definition."""
