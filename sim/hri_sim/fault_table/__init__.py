"""``hri-predict bench faults`` and ``bench soak``: the measured effects of faults."""
