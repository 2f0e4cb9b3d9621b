"""What people look at while the node runs: the 3D view and the operator page.

Each is a process of its own. The node hands over the newest tick (``feed``); a hung or dead screen
costs pictures, which are counted, and never a tick.
"""
