"""Where the next foot goes: capture regions, footholds, the swing."""
