"""One picture as a camera would take it, and the figures of what happened: what ``blurnoise simulate`` does."""
