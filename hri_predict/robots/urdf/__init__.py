"""Conversion of URDF to robot files."""
