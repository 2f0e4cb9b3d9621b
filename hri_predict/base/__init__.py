"""Values, files and the machine: code shared by all packages, independent of the domain."""
