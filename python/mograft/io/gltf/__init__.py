"""Reading of glTF 2.0 files, binary (``.glb``) and text (``.gltf``)."""
