"""How fast the heading drifts: at rest, in the air, and around its mean drift."""
