"""The calibration of a camera by a printed chessboard."""
