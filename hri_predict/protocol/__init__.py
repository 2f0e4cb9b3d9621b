"""Messages and their encoding: the one definition that the DBC and the documents come from."""
