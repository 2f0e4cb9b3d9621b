"""What may stand in a configuration: a JSON schema for editors, a page of the documents."""
