"""Publish and subscribe in a ROS 2 graph, by DDS alone.

A topic `/plan` is `rt/plan` in DDS. All goes over the loopback interface, without multicast, unless another interface
is named. What is published on a topic whose type or quality of service others do not share never arrives, and DDS
says so to nobody: `Graph.troubles` does.
"""

import os
import re
import socket
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Generic
from xml.sax.saxutils import quoteattr

from cyclonedds.core import DDSException, InstanceState, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from pirrht.errors import OptionError
from sim.ros.messages import HASHES, Message

LOOPBACK = "127.0.0.1"
MOST_NODES = 32  # that are looked for on a machine where there is no multicast
DEEP = 100  # messages of a queue at most
BLOCKED = 0.1  # for which a reliable publisher waits for a full queue [s]
NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")
ALL = -1
MOST_DOMAIN = 232
OPTIONS = ("domain", "interface", "peer", "namespace", "remap", "qos")  # of a command line, for `Graph.of`


@dataclass(frozen=True, slots=True)
class Quality:
    """Quality of service of a topic.

    Its text is `reliable` or `best-effort`, `latched` for who joins late (transient local), and a depth: `reliable,10`.
    """

    reliable: bool = True
    latched: bool = False
    depth: int = 1

    @classmethod
    def of(cls, text: str) -> "Quality":
        """The quality of a text; OptionError: it is none."""
        words = {"reliable": {"reliable": True}, "best-effort": {"reliable": False}, "latched": {"latched": True},
                 "volatile": {"latched": False}}  # fmt: skip
        found = dict[str, Any]()
        for word in text.split(","):
            if word.isdigit() and 1 <= int(word) <= DEEP:
                found["depth"] = int(word)
            elif word in words:
                found |= words[word]
            else:
                raise OptionError(
                    f"a quality of service has no {word[:40]!r}; it is a list of {', '.join(words)} and a depth up to "
                    f"{DEEP}, such as reliable,latched,1"
                )
        return cls(**found)

    def policies(self, *, writer: bool, kind: type[IdlStruct]) -> Qos:
        """Return it as DDS has it, with ROS's hash of a published type."""
        reliable = Policy.Reliability.Reliable(duration(seconds=BLOCKED))
        latched = [Policy.DurabilityService(0, Policy.History.KeepLast(self.depth), ALL, ALL, ALL)]
        known = [Policy.Userdata(f"typehash=RIHS01_{HASHES[kind]};".encode())] if writer and kind in HASHES else []
        return Qos(
            reliable if self.reliable else Policy.Reliability.BestEffort,
            Policy.Durability.TransientLocal if self.latched else Policy.Durability.Volatile,
            Policy.History.KeepLast(self.depth),
            Policy.DataRepresentation(use_cdrv0_representation=True),
            *(latched if writer and self.latched else []), *known,
        )  # fmt: skip


SENSOR = Quality(reliable=False, depth=5)
RELIABLE = Quality(depth=10)
LATCHED = Quality(latched=True)


class Publisher(Generic[Message]):
    """Publishes messages of a topic."""

    def __init__(self, name: str, writer: DataWriter[Message]) -> None:
        self.name = name
        self._writer = writer

    @property
    def heard(self) -> bool:
        """Whether anybody subscribes."""
        return bool(self._writer.get_publication_matched_status().current_count)

    def publish(self, message: Message) -> None:
        """Send a message; one that a full queue cannot take is lost."""
        try:
            self._writer.write(message)
        except DDSException as error:
            if error.code != DDSException.DDS_RETCODE_TIMEOUT:
                raise

    def refused(self) -> bool:
        """Whether somebody who subscribes demands another quality of service."""
        return bool(self._writer.get_offered_incompatible_qos_status().total_count_change)


class Subscription(Generic[Message]):
    """Has the messages of a topic that came since they were last taken."""

    def __init__(self, name: str, reader: DataReader[Message], kind: type[Message]) -> None:
        self.name = name
        self._kind = kind
        self._reader = reader
        self.news = ReadCondition(reader, SampleState.NotRead | ViewState.Any | InstanceState.Any)

    @property
    def offered(self) -> bool:
        """Whether anybody publishes."""
        return bool(self._reader.get_subscription_matched_status().current_count)

    def take(self) -> list[Message]:
        """Return all new messages, the oldest first."""
        found = self._reader.take(N=DEEP)
        return [one for one in found if isinstance(one, self._kind)]  # not that a publisher has gone

    def refused(self) -> bool:
        """Whether somebody publishes in a quality of service that is less than demanded."""
        return bool(self._reader.get_requested_incompatible_qos_status().total_count_change)


class Graph:
    """A participant in a ROS 2 graph.

    Args:
        domain: number of the graph, ROS_DOMAIN_ID elsewhere.
        interface: name or address of the network interface; None: loopback.
        peers: addresses where nodes are looked for as well.
        namespace: put before names of topics that do not begin with a slash.
        remap: other names of topics, by name.
        qualities: other qualities of service, by name of the topic.

    Raises:
        OptionError: there is no such interface, or a name is none.
    """

    def __init__(
        self, domain: int = 0, interface: str | None = None, peers: Sequence[str] = (), namespace: str = "",
        remap: Mapping[str, str] | None = None, qualities: Mapping[str, Quality] | None = None,
    ) -> None:  # fmt: skip
        self.namespace = checked_name(namespace, "the namespace") if namespace.strip("/") else ""
        self._remap = dict[str, str]()
        self._remap = {self.full(name): self.full(other) for name, other in (remap or {}).items()}
        self._qualities = {self.full(name): quality for name, quality in (qualities or {}).items()}
        for peer in peers:
            check_address(peer)
        try:
            self._domain = joined(domain, configuration(interface, peers))
            self._participant = DomainParticipant(domain)
        except DDSException:
            there = ", ".join(name for _, name in socket.if_nameindex())
            raise OptionError(
                f"no DDS on the interface {interface or LOOPBACK}; name one of {there} that is up, or its address"
            ) from None
        self._waits = WaitSet(self._participant)
        self._ends = list[Publisher[Any] | Subscription[Any]]()

    @classmethod
    def of(
        cls, *, domain: int | None = None, interface: str | None = None, peer: Sequence[str] | None = None,
        namespace: str | None = None, remap: Iterable[str] | None = None, qos: Iterable[str] | None = None,
    ) -> "Graph":  # fmt: skip
        """Join a graph by what a command line says: the options in `OPTIONS`; OptionError: one of them cannot be."""
        known = os.environ.get("ROS_DOMAIN_ID", "").strip() or "0"
        if domain is None and not (known.isdigit() and int(known) <= MOST_DOMAIN):
            raise OptionError(f"ROS_DOMAIN_ID is {known[:40]!r}; it must be a number from 0 to {MOST_DOMAIN}")
        qualities = {name: Quality.of(text) for name, text in pairs(qos, "=", "--qos scan=reliable,10").items()}
        names = pairs(remap, ":=", "--remap scan:=front/scan")
        return cls(int(known) if domain is None else domain, interface, peer or (), namespace or "", names, qualities)

    def full(self, name: str) -> str:
        """Return a topic's whole name, remapped; OptionError: it is none."""
        checked_name(name, "the topic")
        whole = name if name.startswith("/") else f"/{self.namespace}/{name}".replace("//", "/")
        return self._remap.get(whole, whole)

    def publisher(self, name: str, kind: type[Message], quality: Quality = RELIABLE) -> Publisher[Message]:
        """Publish a topic, with a slash in front or in the namespace."""
        full = self.full(name)
        topic = Topic(self._participant, f"rt{full}", kind)
        quality = self._qualities.get(full, quality)
        made = Publisher[Message](full, DataWriter(self._participant, topic, quality.policies(writer=True, kind=kind)))
        self._ends.append(made)
        return made

    def subscription(self, name: str, kind: type[Message], quality: Quality = RELIABLE) -> Subscription[Message]:
        """Subscribe to a topic, with a slash in front or in the namespace."""
        full = self.full(name)
        topic = Topic(self._participant, f"rt{full}", kind)
        quality = self._qualities.get(full, quality)
        reader = DataReader(self._participant, topic, quality.policies(writer=False, kind=kind))
        made = Subscription(full, reader, kind)
        self._waits.attach(made.news)
        self._ends.append(made)
        return made

    def check(self) -> None:
        """Refuse another name or quality of a topic that nothing here publishes or subscribes to, by an OptionError."""
        known = {one.name for one in self._ends}
        strange = [name for name, other in self._remap.items() if other not in known]
        for name in (*strange, *(name for name in self._qualities if name not in known)):
            raise OptionError(f"--remap or --qos: there is no topic {name}; topics are {', '.join(sorted(known))}")

    def wait(self, seconds: float) -> None:
        """Return when there is a message, or a time [s] has passed."""
        self._waits.wait(max(0, round(seconds * 1e9)))

    def troubles(self) -> list[str]:
        """Return a sentence for each topic on which somebody's quality of service does not fit, since the last call."""
        return [
            f"{one.name}: another node's type or quality of service does not fit, so nothing arrives (--qos)"
            for one in self._ends if one.refused()
        ]  # fmt: skip


@cache
def joined(domain: int, known: str) -> Domain:
    """Return a domain by its configuration; a process has each once."""
    return Domain(domain, known)


def pairs(words: Iterable[str] | None, sign: str, example: str) -> dict[str, str]:
    """Return what stands before and after a sign in each word; OptionError, with an example: there is no sign."""
    for word in words or ():
        if sign not in word:
            raise OptionError(f"{word[:60]!r} has no {sign}; write it as in {example}")
    return {name: other for name, _, other in (word.partition(sign) for word in words or ())}


def check_address(peer: str) -> None:
    """Refuse what is no address by an OptionError; DDS would end the process."""
    try:
        socket.getaddrinfo(peer, None, socket.AF_INET)
    except (OSError, UnicodeError):
        raise OptionError(f"--peer {peer[:60]!r} is no address; give one as 192.168.0.7") from None


def checked_name(name: str, what: str) -> str:
    """Return a name of ROS as it is; OptionError: it is none."""
    if not NAME.fullmatch(name.strip("/")) or name.endswith("/"):
        raise OptionError(f"{what} is {name[:60]!r}; it must be words of letters, digits and _, with / between them")
    return name


def configuration(interface: str | None, peers: Sequence[str]) -> str:
    """Return what Cyclone DDS reads: loopback alone, found by address; another interface with multicast."""
    own = "address" if interface is None or interface[:1].isdigit() else "name"
    local = interface is None
    known = [LOOPBACK, *peers] if local else peers
    found = "".join(f"<Peer address={quoteattr(one)}/>" for one in known)
    return (
        "<CycloneDDS><Domain><General><Interfaces>"
        f"<NetworkInterface {own}={quoteattr(interface or LOOPBACK)}/>"
        f"</Interfaces><AllowMulticast>{'false' if local else 'default'}</AllowMulticast></General>"
        f"<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>{MOST_NODES}"
        f"</MaxAutoParticipantIndex><Peers>{found}</Peers></Discovery></Domain></CycloneDDS>"
    )
