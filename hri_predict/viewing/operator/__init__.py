"""The operator's pages, of one cell and of many: legible from three metres."""
