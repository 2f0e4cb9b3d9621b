"""Motion file formats, one file each."""
