"""The predictor in a process of its own: shared memory, the worker, and its restarts."""
