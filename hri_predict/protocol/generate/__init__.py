"""Files generated from the protocol definition: DBC, C header, documents, examples."""
