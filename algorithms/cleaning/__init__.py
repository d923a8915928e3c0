"""What scans lose or change before they are taken away: crops, comet tails, doubles, noise, moved objects."""
