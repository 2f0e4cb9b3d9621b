"""Lost people: who vanished, where they may be, and how being lost ends."""
