"""Lost people: people who vanished, where they may be, and when they stop being lost."""
