"""Shared by all trained predictors: skeleton, frame, network contract, weights."""
