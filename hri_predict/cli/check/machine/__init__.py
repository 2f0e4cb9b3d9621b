"""``check --realtime``: the machine that the node runs on."""
