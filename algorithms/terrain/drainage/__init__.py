"""Where water runs on a terrain: derivatives, rain, hollows, valleys and ridges.

P. Dorninger, *Analyse und geomorphologische Verbesserung von Geländemodellen mittels Regensimulation*, VGI 4/2003.
"""
