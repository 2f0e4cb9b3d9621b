"""``explain`` and ``report``: explanations and shift reports from recordings."""
