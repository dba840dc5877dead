"""The pages of the studio: each module registers the function that adds its pages under `rvsg.pages`."""
