#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# with_layer.sh SCRIPT TOOL SOURCE WORK: runs a script of the command line with the validation layer. Whatever the layer
# says to a process of the tool is a failure, and so is a layer that no process has loaded.
script=$1 layer=$4.layer
rm -rf "$layer" && mkdir -p "$layer" || exit 1
# What the script takes for the tool: it gives each process a file for the layer's messages, and becomes the tool.
cat >"$layer/splatguard" <<END
#!/bin/sh
VK_LAYER_SETTINGS_PATH=\$(mktemp -d '$layer/XXXXXX')
sed "s|^\(khronos_validation.log_filename = \).*|\1\$VK_LAYER_SETTINGS_PATH/messages|" '$3/tests/vulkan/vk_layer_settings.txt' \
    >"\$VK_LAYER_SETTINGS_PATH/vk_layer_settings.txt"
export VK_LAYER_SETTINGS_PATH VK_INSTANCE_LAYERS=VK_LAYER_KHRONOS_validation
exec '$2' "\$@"
END
chmod +x "$layer/splatguard"
sh "$script" "$layer/splatguard" "$3" "$4" || exit
messages=$(find "$layer" -name messages -size +0 -exec cat {} +)
loaded=$(find "$layer" -name messages | wc -l)
echo "$loaded processes had the layer. $messages"
[ "$loaded" -gt 0 ] && [ -z "$messages" ]
