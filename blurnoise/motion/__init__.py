"""Motion in the picture: paths over time, their causes, and cameras on vehicles."""
