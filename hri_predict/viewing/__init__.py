"""Screens for people while nodes run: the 3D view and the operator's pages.

Each is a process of its own. The node hands over the newest tick (``feed``); a hung or dead screen
costs pictures, which are counted, and never a tick.
"""
