"""A client that knows the companion specifications, and nothing of the project.

Writes a line of JSON for what it found, and one for each change of a health that it hears of.
"""

import asyncio
import json
import sys

from asyncua import Client, ua

DI, MACHINERY = "http://opcfoundation.org/UA/DI/", "http://opcfoundation.org/UA/Machinery/"
MACHINE_TOOL = "http://opcfoundation.org/UA/MachineTool/"


def say(what):
    sys.stdout.write(json.dumps(what) + "\n")
    sys.stdout.flush()


async def with_status(node):
    read = await node.read_data_value(raise_on_bad_status=False)
    value = read.Value.Value
    text = value.Text if isinstance(value, ua.LocalizedText) else value
    return text, read.StatusCode.name


async def below(node, depth=8):
    found = {}
    for child in await node.get_children() if depth else ():
        found[child.nodeid] = child
        found |= await below(child, depth - 1)
    return found


class Changes:
    def datachange_notification(self, node, value, data):
        status = data.monitored_item.Value.StatusCode.name
        say({"health": value, "status": status})


async def main(url, changes):
    async with Client(url) as client:
        index = {uri: number for number, uri in enumerate(await client.get_namespace_array())}
        kinds = {
            ua.NodeId(13, index[MACHINE_TOOL]): "machine",
            ua.NodeId(9, index[MACHINE_TOOL]): "prognosis",
            ua.NodeId(468, index[DI]): "lifetime",
        }
        machines = client.get_node(ua.NodeId(1001, index[MACHINERY]))
        found = {"machine": [], "prognosis": {}, "lifetime": [], "health": {}}
        healths = []
        for node in (await below(machines)).values():
            name = await node.read_browse_name()
            if await node.read_node_class() == ua.NodeClass.Object:
                kind = kinds.get(await node.read_type_definition())
                if kind == "machine":
                    found["machine"].append(name.Name)
                elif kind == "prognosis":
                    text = await node.get_child(f"{index[MACHINE_TOOL]}:Activity")
                    time = await node.get_child(f"{index[MACHINE_TOOL]}:PredictedTime")
                    read = [*await with_status(text), *map(str, await with_status(time))]
                    found["prognosis"][name.Name] = read
            elif (name.Name, name.NamespaceIndex) == ("DeviceHealth", index[DI]):
                axis = await (await node.get_parent()).read_browse_name()
                found["health"][axis.Name] = await with_status(node)
                healths.append(node)
            elif kinds.get(await node.read_type_definition()) == "lifetime":
                limit = await node.get_child(f"{index[DI]}:LimitValue")
                start = await node.get_child(f"{index[DI]}:StartValue")
                limits = [await start.read_value(), await limit.read_value()]
                found["lifetime"].append([*await with_status(node), *limits])
        refused = []
        for node in (*healths, machines):
            try:
                await node.write_attribute(
                    ua.AttributeIds.Value, ua.DataValue(ua.Variant(1, ua.VariantType.Int32))
                )
            except ua.UaStatusCodeError as error:
                refused.append(error.code == ua.StatusCodes.BadUserAccessDenied)
        found["writes_refused"] = len(refused) == 1 + len(healths) and all(refused)
        say(found)
        if changes:
            subscription = await client.create_subscription(100, Changes())
            await subscription.subscribe_data_change(healths)
            await asyncio.to_thread(sys.stdin.readline)


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], "changes" in sys.argv[2:]))
