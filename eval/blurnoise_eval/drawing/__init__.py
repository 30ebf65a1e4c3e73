"""Pictures with boxes, galleries, photon transfer."""
