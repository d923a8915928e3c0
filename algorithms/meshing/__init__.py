"""Triangle meshes, plane models and spline patches of registered clouds."""
