"""Extended Gaussian images: the directions of surfaces on a tessellated sphere, and how two of them are turned."""
