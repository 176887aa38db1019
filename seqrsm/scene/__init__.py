"""Ground-truth data bases: elevation, cover category and field of every cell (RSL TR 380-1 section 3.2.2.2)."""
