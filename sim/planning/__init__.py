"""What a scene needs: patches, method, solver and cost for a tolerance."""
