"""Everything that runs without hardware: replay, procedural people, faults, mock controllers."""
