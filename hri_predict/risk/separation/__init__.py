"""Separation: present and required distances between people and robots."""
