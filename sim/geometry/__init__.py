"""Scenes, meshes and rays: flat patches and where they lie."""
