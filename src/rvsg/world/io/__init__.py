"""Read and write worlds: the world folder, Nav2 maps, SDF and meshes."""
