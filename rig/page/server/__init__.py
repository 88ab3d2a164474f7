"""What every part of the page's server needs: who may ask, who holds the rig, what is told, where files lie."""
