"""The allowed content of a configuration: a JSON schema for editors, a page of the documents."""
