"""Screens for people while nodes run: the 3D view and the operator's pages.

Each runs in a separate process. The node passes on the newest tick (``feed``); a hung or dead
screen loses pictures, which are counted, but never delays a tick.
"""
