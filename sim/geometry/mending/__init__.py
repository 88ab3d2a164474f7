"""Any mesh made one that light can be computed in: polygons cut, corners merged, facets turned, faults named."""
