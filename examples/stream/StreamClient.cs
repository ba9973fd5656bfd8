// A client of `mograft stream` in C# without packages, for .NET, Mono and Unity.
//
//   mcs StreamClient.cs           (or: a console project of dotnet with this file)
//   mono StreamClient.exe PORT FRAMES OUTPUT
//
// FRAMES holds float32 numbers: for each frame the local rotations of all joints (x, y, z, w) and
// the translation of the root. The client sends one frame at a time, as an engine does, and writes
// the frames that it receives to OUTPUT: rotations, then translations, of all joints.
// docs/howto/stream.md describes the protocol. The machine must be little-endian.

using System;
using System.Globalization;
using System.IO;
using System.Net;
using System.Net.Sockets;
using System.Text;
using System.Text.RegularExpressions;

public sealed class StreamReply
{
    public string Header;  // JSON
    public byte[] Body;    // the arrays, in the order of the header

    // Returns the number after "name": in the header; Unity's JsonUtility reads all of it.
    public int Number(string name)
    {
        Match match = Regex.Match(Header, "\"" + name + "\": (-?[0-9]+)");
        if (!match.Success) throw new InvalidDataException("no " + name + " in " + Header);
        return int.Parse(match.Groups[1].Value, CultureInfo.InvariantCulture);
    }
}

public sealed class StreamClient : IDisposable
{
    private readonly TcpClient client;
    private readonly NetworkStream stream;

    public StreamClient(int port)
    {
        client = new TcpClient { NoDelay = true };
        client.Connect(IPAddress.Loopback, port);
        stream = client.GetStream();
    }

    public void Dispose()
    {
        stream.Dispose();
        client.Close();
    }

    public StreamReply Request(string header, byte[] body = null)
    {
        byte[] text = Encoding.UTF8.GetBytes(header);
        int size = body == null ? 0 : body.Length;
        byte[] message = new byte[12 + text.Length + size];
        Encoding.ASCII.GetBytes("MGS1", 0, 4, message, 0);
        BitConverter.GetBytes(text.Length).CopyTo(message, 4);
        BitConverter.GetBytes(size).CopyTo(message, 8);
        text.CopyTo(message, 12);
        if (size > 0) body.CopyTo(message, 12 + text.Length);
        stream.Write(message, 0, message.Length);
        return Receive();
    }

    private StreamReply Receive()
    {
        byte[] prefix = Read(12);
        if (Encoding.ASCII.GetString(prefix, 0, 4) != "MGS1")
            throw new InvalidDataException("not mograft.stream/1");
        StreamReply reply = new StreamReply();
        reply.Header = Encoding.UTF8.GetString(Read(BitConverter.ToInt32(prefix, 4)));
        reply.Body = Read(BitConverter.ToInt32(prefix, 8));
        if (reply.Header.Contains("\"type\": \"error\""))
            throw new InvalidDataException(reply.Header);
        return reply;
    }

    private byte[] Read(int size)
    {
        byte[] data = new byte[size];
        for (int got = 0; got < size;)
        {
            int n = stream.Read(data, got, size - got);
            if (n == 0) throw new EndOfStreamException("the server has closed the connection");
            got += n;
        }
        return data;
    }
}

public static class Program
{
    private static string PushHeader(int joints)
    {
        return "{\"type\": \"push\", \"arrays\": ["
            + "{\"name\": \"rotations\", \"dtype\": \"float32\", \"shape\": [1, " + joints + ", 4]}, "
            + "{\"name\": \"positions\", \"dtype\": \"float32\", \"shape\": [1, 3]}]}";
    }

    // Writes the frames of a reply and returns their number, which is 0 for most replies.
    private static int Play(StreamReply pieces, int joints, Stream output)
    {
        int n = pieces.Number("n_frames"), rotations = joints * 4 * 4, positions = joints * 3 * 4;
        for (int i = 0; i < n; i++)
        {
            output.Write(pieces.Body, i * rotations, rotations);
            output.Write(pieces.Body, n * rotations + i * positions, positions);
        }
        return n;
    }

    public static int Main(string[] arguments)
    {
        if (arguments.Length != 3)
        {
            Console.Error.WriteLine("usage: StreamClient PORT FRAMES OUTPUT");
            return 2;
        }
        int port = int.Parse(arguments[0], CultureInfo.InvariantCulture);
        using (StreamClient client = new StreamClient(port))
        using (FileStream frames = File.OpenRead(arguments[1]))
        using (FileStream output = File.Create(arguments[2]))
        {
            StreamReply welcome = client.Request(
                "{\"type\": \"hello\", \"protocol\": \"mograft.stream/1\", \"seed\": 7, \"horizon\": 4}");
            int joints = welcome.Number("n_joints"), received = 0;
            byte[] frame = new byte[(joints * 4 + 3) * 4];
            while (ReadFrame(frames, frame))
                received += Play(client.Request(PushHeader(joints), frame), joints, output);
            received += Play(client.Request("{\"type\": \"close\"}"), joints, output);
            Console.WriteLine(received + " frames");
        }
        return 0;
    }

    private static bool ReadFrame(Stream frames, byte[] frame)
    {
        int got = 0, n = 1;
        while (got < frame.Length && n > 0)
        {
            n = frames.Read(frame, got, frame.Length - got);
            got += n;
        }
        return got == frame.Length;
    }
}
