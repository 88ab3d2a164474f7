"""Scenes of one flat wall: what the points leave open is held by data sheets, and said."""
