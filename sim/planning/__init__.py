"""What a scene needs: cells, method, solver and cost for a tolerance."""
