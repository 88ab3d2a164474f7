"""Chessboards in pictures: their corners one by one, which are neighbours, and what part of a board is seen."""
