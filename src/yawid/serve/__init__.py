"""``yawid serve``: a folder's flights as pages for one person on this machine."""
