"""Calibration of a camera with a printed chessboard."""
