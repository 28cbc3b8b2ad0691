"""Methods that assume contact: pressure only pushes, and shear stays within friction. Open `search.py` first."""
