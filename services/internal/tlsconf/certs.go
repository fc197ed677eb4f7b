package tlsconf

import (
	"crypto/ecdsa"
	"crypto/elliptic"
	"crypto/rand"
	"crypto/x509"
	"crypto/x509/pkix"
	"encoding/pem"
	"errors"
	"fmt"
	"math/big"
	"net"
	"os"
	"path/filepath"
	"time"
)

// Lifetimes of what Generate makes. The authority's key lies beside the others, so nothing of it
// should last.
const (
	generatedLifetime = 365 * 24 * time.Hour
	clockSkew         = time.Hour
	serialBits        = 127
)

// issued is a certificate with its key.
type issued struct {
	certificate *x509.Certificate
	key         *ecdsa.PrivateKey
}

// generated files.
var generated = [...]string{"ca.crt", "ca.key", "server.crt", "server.key", "worker.crt", "worker.key"}

// Generate makes a private authority and, signed by it, a certificate of a server with the names
// hosts and one of workers: ca.crt, server.crt, worker.crt, each with its .key, in the folder dir.
// Files that exist are not replaced.
func Generate(dir string, hosts []string, now time.Time) error {
	if err := os.MkdirAll(dir, 0o750); err != nil {
		return err
	}
	for _, name := range generated {
		if _, err := os.Lstat(filepath.Join(dir, name)); err == nil {
			return fmt.Errorf("%s exists; choose another folder", filepath.Join(dir, name))
		}
	}
	ca, err := issue(nil, authority(), now)
	if err != nil {
		return fmt.Errorf("making the authority: %w", err)
	}
	server, err := issue(ca, leaf("metrofarm server", x509.ExtKeyUsageServerAuth, hosts), now)
	if err != nil {
		return fmt.Errorf("making the server's certificate: %w", err)
	}
	worker, err := issue(ca, leaf("metrofarm worker", x509.ExtKeyUsageClientAuth, nil), now)
	if err != nil {
		return fmt.Errorf("making the workers' certificate: %w", err)
	}
	return errors.Join(ca.write(dir, "ca"), server.write(dir, "server"), worker.write(dir, "worker"))
}

func authority() *x509.Certificate {
	return &x509.Certificate{
		Subject: pkix.Name{CommonName: "metrofarm authority"}, IsCA: true, BasicConstraintsValid: true,
		MaxPathLenZero: true, KeyUsage: x509.KeyUsageCertSign | x509.KeyUsageCRLSign,
	}
}

func leaf(name string, usage x509.ExtKeyUsage, hosts []string) *x509.Certificate {
	template := &x509.Certificate{
		Subject: pkix.Name{CommonName: name}, BasicConstraintsValid: true,
		KeyUsage: x509.KeyUsageDigitalSignature, ExtKeyUsage: []x509.ExtKeyUsage{usage},
	}
	for _, host := range hosts {
		if ip := net.ParseIP(host); ip != nil {
			template.IPAddresses = append(template.IPAddresses, ip)
		} else {
			template.DNSNames = append(template.DNSNames, host)
		}
	}
	return template
}

// issue signs a template by an authority; nil: by itself.
func issue(by *issued, template *x509.Certificate, now time.Time) (*issued, error) {
	key, err := ecdsa.GenerateKey(elliptic.P256(), rand.Reader)
	if err != nil {
		return nil, err
	}
	template.NotBefore, template.NotAfter = now.Add(-clockSkew), now.Add(generatedLifetime)
	if template.SerialNumber, err = rand.Int(rand.Reader, new(big.Int).Lsh(big.NewInt(1), serialBits)); err != nil {
		return nil, err
	}
	parent, signer := template, key
	if by != nil {
		parent, signer = by.certificate, by.key
	}
	der, err := x509.CreateCertificate(rand.Reader, template, parent, &key.PublicKey, signer)
	if err != nil {
		return nil, err
	}
	certificate, err := x509.ParseCertificate(der)
	return &issued{certificate, key}, err
}

func (i *issued) write(dir, name string) error {
	key, err := x509.MarshalPKCS8PrivateKey(i.key)
	if err != nil {
		return err
	}
	return errors.Join(
		writePEM(filepath.Join(dir, name+".key"), "PRIVATE KEY", key, 0o600),
		writePEM(filepath.Join(dir, name+".crt"), "CERTIFICATE", i.certificate.Raw, 0o644),
	)
}

func writePEM(path, kind string, der []byte, mode os.FileMode) error {
	file, err := os.OpenFile(path, os.O_WRONLY|os.O_CREATE|os.O_EXCL, mode)
	if err != nil {
		return err
	}
	return errors.Join(pem.Encode(file, &pem.Block{Type: kind, Bytes: der}), file.Close())
}
