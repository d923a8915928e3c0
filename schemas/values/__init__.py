"""Values that requests and answers share: poses, names, units, links, problems."""
