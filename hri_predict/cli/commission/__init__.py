"""``hri-predict commission``: the validation of one cell, step by step."""
